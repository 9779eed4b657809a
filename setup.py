"""Writes the commit into what is built; everything else is in pyproject.toml."""

from __future__ import annotations

import subprocess
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithCommit(build_py):
    """A built package has no git around it: it carries the commit as a file."""

    def run(self) -> None:
        """Build, then write ``ptzd/commit.txt`` where git knows the commit."""
        super().run()
        if not (Path(__file__).parent / ".git").exists():
            return
        command = ["git", "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parent)
        except (OSError, subprocess.CalledProcessError):
            return
        target = Path(self.build_lib) / "ptzd" / "commit.txt"
        if target.parent.is_dir():
            target.write_text(done.stdout)


setup(cmdclass={"build_py": BuildWithCommit})
