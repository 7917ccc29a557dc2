"""What watches a bridge, in a process beside those that move messages."""
