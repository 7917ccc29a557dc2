"""Dead letters: how one is made and written, what it holds, and which are chosen.

Values, and the way to a sink that is given: no Kafka client, no configuration, no format.
"""
