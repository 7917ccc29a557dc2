"""What every page of this distribution needs: who may talk to it, its stream, its script.

The page of a bridge (`monitoring/`) and that of the warehouse are made of it. It knows neither,
and nothing of what they show.
"""
