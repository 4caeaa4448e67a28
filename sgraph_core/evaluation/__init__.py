"""How good an inference is: the scores of docs/scores.md."""
