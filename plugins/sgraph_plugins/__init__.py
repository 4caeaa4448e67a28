"""The concepts that ship with the framework, each a folder a third party could have written."""
