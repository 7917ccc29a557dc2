"""`schema`: the schema of a message type."""
