"""The judges are programs: they import what only their own environment has."""

collect_ignore_glob = ["*_judge.py", "wire.py", "lengths_line.py"]
