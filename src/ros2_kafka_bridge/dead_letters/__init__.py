"""Dead letters: how one is made, what it holds, and which are chosen.

Values: no Kafka client, no configuration, no format. `route/dead_letters.py` writes them.
"""
