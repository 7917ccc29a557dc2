"""Which of several bridges runs a route: a wrapper around whatever runs it.

`Leadership` waits until this bridge is the one, lets the route run for a term, and hands it over.
What it wraps gets an ordinary stop, and knows of no lock.
"""
