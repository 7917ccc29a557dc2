"""What the processes of one bridge tell each other, and what is read of it, in the same words.

Values only: who sends and who answers is in `process`, `monitoring` and `ros`.
"""
