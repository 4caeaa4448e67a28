# make demo: set up, then infer and optimise the bundled map
# make test: set up, then run the tests
# Both work in a fresh clone with Python 3.11 or 3.12 and make only.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := docs/demo/office
OUT := build/demo

.PHONY: demo test check weights clean

demo: $(VENV)/demo.stamp
	@mkdir -p $(OUT)
	$(BIN)/sgraph infer $(DEMO).json --optimize -o $(OUT)/optimised.json --plot $(OUT)/optimised.png
	@echo; echo "Rooms and walls of the optimised map:"
	$(BIN)/sgraph infer $(OUT)/optimised.json
	@echo; echo "Scores and trajectory error, before and after:"
	$(BIN)/sgraph evaluate --trajectory $(DEMO).tum $(DEMO).json $(OUT)/optimised.json
	@echo; echo "The map is $(OUT)/optimised.json, its picture $(OUT)/optimised.png"

test: $(VENV)/test.stamp
	$(BIN)/pytest -n auto

check: $(VENV)/test.stamp
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Train from nothing and install the weights where they are shipped from (docs/training.md).
weights: $(VENV)/test.stamp
	$(BIN)/sgraph train -o build/weights --seed 1 --stop 600
	cp build/weights/encoder.onnx build/weights/encoder.safetensors build/weights/training.json sgraph_core/weights/
	cp build/weights/room.onnx plugins/sgraph_plugins/room/
	cp build/weights/wall.onnx plugins/sgraph_plugins/wall/

$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or 3.12 is needed: make PYTHON=python3.12 ...") if not (3, 11) <= sys.version_info[:2] <= (3, 12) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip

$(VENV)/demo.stamp: pyproject.toml | $(BIN)/python
	$(BIN)/pip install --quiet -e .
	touch $@

$(VENV)/test.stamp: pyproject.toml | $(BIN)/python
	$(BIN)/pip install --quiet -e '.[train,dev]'
	touch $@ $(VENV)/demo.stamp

clean:
	rm -rf $(VENV) build dist
