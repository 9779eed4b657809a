"""200 random rigs: how often the truth lies inside the 3 sigma ellipsoid: `python tests/bench/recovery.py [RUNS]`."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path


def main(runs: int) -> int:
    path = Path(__file__).parents[1] / "calibration" / "test_recovery.py"
    spec = importlib.util.spec_from_file_location("test_recovery", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    worst = 1.0
    for name in ("lens_run", "rig_run", "pairs_run"):
        inside = sum(bool(getattr(module, name)(seed)) for seed in range(runs))
        worst = min(worst, inside / runs)
        print(f"{name:10} {inside} of {runs} inside 3 sigma")
    return 0 if worst >= 0.95 else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 200))
