# Runs the README's two commands in a clean system: docker build . does both.
FROM python:3.12-slim
RUN apt-get update && apt-get install --yes --no-install-recommends make && rm -rf /var/lib/apt/lists/*
WORKDIR /sgraph-concepts
COPY . .
RUN make demo
RUN make test
ENV PATH="/sgraph-concepts/.venv/bin:$PATH"
CMD ["sgraph", "--help"]
