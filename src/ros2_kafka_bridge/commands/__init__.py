"""What the commands do that only look or write a file: `check`, `topics` and `init`."""
