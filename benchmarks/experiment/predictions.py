"""What `ros2-kafka-bridge depth` expects of a recording, beside what was measured."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.experiment.cell import recording_file
from benchmarks.experiment.results import Prediction, Result
from ros2_kafka_bridge import depth
from ros2_kafka_bridge.depth.recording import read_recording


def predictions(found: Sequence[Result], recordings: Path) -> Sequence[Prediction]:
    """Predict the loss of each of the paper's cells whose load was recorded."""
    recorded = [result for result in found if result.cell.contestant == 'recording']
    papers = [result for result in found if result.cell.contestant == 'paper']
    return [
        prediction
        for recording in recorded
        for prediction in _of_load(
            recording_file(recordings, recording.cell),
            [result for result in papers if result.cell.load == recording.cell.load],
        )
    ]


def _of_load(recording: Path, papers: Sequence[Result]) -> Iterator[Prediction]:
    counts = {
        result.cell.depth: result.counts for result in papers if result.cell.depth is not None
    }
    if not counts or not recording.exists():
        return
    arrivals_ns, service_ns, wake_ns, _ = read_recording(recording)
    for predicted in depth.predict(arrivals_ns, service_ns, list(counts), wake_ns=wake_ns):
        found = counts[predicted.depth]
        yield Prediction(
            load=papers[0].cell.load,
            depth=predicted.depth,
            loss=predicted.loss,
            low=predicted.low,
            high=predicted.high,
            seen=predicted.seen,
            measured=max(0.0, 1 - found.ros_kafka / max(1, found.kafka_ros)),
            messages=found.kafka_ros,
        )
