"""`status`: how the running bridge is doing."""
