"""The structure of a map file, and where a document breaks it: place, value and rule."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from pydantic import ValidationError

from sgraph_concepts.errors import shorten
from sgraph_core.map_schema import MapRecord
from sgraph_core.tables import RuleError

__all__ = [
    "REQUIRED",
    "Steps",
    "StructureError",
    "place_of",
    "refuse_lone_surrogates",
    "structured",
]

Steps = tuple[int | str, ...]
"""Keys and indices that lead to a place in a document."""
REQUIRED = "is required"
"""The rule that a value breaks which is not there."""
RULES = {
    "extra_forbidden": "unknown key",
    "missing": REQUIRED,
    "model_type": "must be an object",
    "model_attributes_type": "must be an object",
}


class StructureError(RuleError):
    """A document breaks the structure of a map file; ``steps`` lead to the place."""

    def __init__(self, steps: Steps, value: object, rule: str) -> None:
        super().__init__(place_of(steps), value, rule)
        self.steps = steps
        self.args = (f"{self.place} = {shorten(value, repr)}: {rule}",)


def structured(document: Any) -> MapRecord:
    """Return a map file's document, as a JSON reader returns it, as records.

    Raises:
        StructureError: for the first value that breaks a rule.
    """
    try:
        return MapRecord.model_validate(document)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
    kind, message, limits = problem["type"], problem["msg"], problem.get("ctx", {})
    rule = RULES.get(kind)
    if kind in ("too_long", "too_short"):
        bound = "at most" if kind == "too_long" else "at least"
        rule = f"must have {bound} {limits.get('max_length', limits.get('min_length'))} items"
    if rule is None:
        rule = message.removeprefix("Value error, ").replace("Input should be", "must be")
    raise StructureError(tuple(_real_steps(problem["loc"], document)), problem["input"], rule)


def refuse_lone_surrogates(document: Any) -> None:
    """Refuse text that is half of a pair of surrogates: it can be neither written nor printed.

    Raises:
        StructureError: for a text that has one.
    """
    parts: list[tuple[Steps, Any]] = [((), document)]
    while parts:
        steps, part = parts.pop()
        if isinstance(part, dict):
            for key, value in part.items():
                parts += [(steps, key), ((*steps, key), value)]
        elif isinstance(part, list):  # of numbers, most of them
            holds_text = (dict, list, str)
            parts += [((*steps, k), v) for k, v in enumerate(part) if isinstance(v, holds_text)]
        elif isinstance(part, str) and any("\ud800" <= letter <= "\udfff" for letter in part):
            raise StructureError(steps, part, "must hold no lone surrogate")


def place_of(steps: Steps) -> str:
    """Return a place as errors name it, such as ``wall_surfaces[3].normal``."""
    return "".join(f"[{s}]" if isinstance(s, int) else f".{s}" for s in steps).removeprefix(".")


def _real_steps(location: Sequence[int | str], document: Any) -> Iterator[int | str]:
    """Drop the steps that pydantic adds for unions: they are not in the document."""
    for k, step in enumerate(location):
        last = k == len(location) - 1
        if isinstance(document, dict) and (step in document or last):
            document = document.get(str(step))
        elif isinstance(document, list) and isinstance(step, int):
            document = document[step] if step < len(document) else None
        else:
            continue
        yield step
