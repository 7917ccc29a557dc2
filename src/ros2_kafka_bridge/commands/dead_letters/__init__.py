"""`dead-letters`: those of a route, shown, and sent again."""
