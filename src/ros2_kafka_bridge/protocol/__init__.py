"""What the processes of one bridge tell each other, and how all of them read it alike.

No pipe and no thread: who sends and who answers is in `process`, `monitoring` and `ros.control`.
"""
