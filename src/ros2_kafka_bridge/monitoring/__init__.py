"""What watches a bridge, in a process beside those that move messages: metrics, health, page.

It may use every room below. No other room imports it: the supervisor starts it.
"""
