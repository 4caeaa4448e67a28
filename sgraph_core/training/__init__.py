"""Training of the shared encoder and the heads on synthetic buildings."""
