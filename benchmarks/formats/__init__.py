"""How fast the formats are, beside what other Python bridges do."""
