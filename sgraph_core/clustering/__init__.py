"""From a scored relation to sets of rows. Concepts use these, or bring their own."""
