"""`topics`: what there is on both sides, and which routes and nodes would match."""
