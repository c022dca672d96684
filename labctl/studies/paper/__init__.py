"""The paper's experiments: what each file under `protocols/experiments/` asks for is acquired, examined and judged."""
