"""The scripts beside the tests are run by hand: they take minutes, and one of them needs SciPy."""

collect_ignore = ["designs.py", "grids.py", "streaming.py"]
