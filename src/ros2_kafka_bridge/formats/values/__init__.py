"""The values of a message between its CDR bytes and a format, by functions made of its layout."""
