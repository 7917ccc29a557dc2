"""What a dead-letter topic holds, and how a letter becomes a record or a message again."""
