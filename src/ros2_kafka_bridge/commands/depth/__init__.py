"""`depth`: which KEEP_LAST depth a reader needs for its traffic."""
