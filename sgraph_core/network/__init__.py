"""The shared encoder and the heads: their definition in torch, their export, their runtime."""

ENCODER_VERSION = "1"
"""Version of the encoder and of its features. Heads declare the one they were trained on."""
