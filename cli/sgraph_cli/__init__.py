"""The command line `sgraph`: it parses, calls the core and prints."""
