"""The command line of sjerk, thin."""

from __future__ import annotations


def main() -> int:
    """Run the command line; returns the exit code."""
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
