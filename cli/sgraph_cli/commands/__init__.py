"""One module per subcommand. Heavy imports stay inside the functions that need them."""
