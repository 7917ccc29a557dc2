"""Measures the allocation and the planning on the public benchmarks of pickup and delivery."""
