"""The processes at the outer ends: what sends orders, and what writes down which have come."""
