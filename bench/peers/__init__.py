"""Hand-written peers that benchmarks are measured against."""
