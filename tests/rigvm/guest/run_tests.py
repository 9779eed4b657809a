"""Runs the suites in the guest and prints the count. usage: run_tests.py reader|service|all SOAK_SECONDS"""

from __future__ import annotations

import sys
import traceback

from checks import Checks, shell


def main(suite: str, soak_s: str) -> int:
    checks = Checks()
    try:
        if suite in ("reader", "all"):
            import reader_suite

            reader_suite.run(checks, float(soak_s))
        if suite in ("service", "all"):
            import service_suite

            service_suite.run(checks)
    except Exception:  # noqa: BLE001  # whatever it was, the verdict must not be missing
        traceback.print_exc(file=sys.stdout)
        checks.that("the suites ran to their end", holds=False)
    if checks.failed:
        print(shell("journalctl --no-pager --lines=200 --unit=ptzd --unit=rigsim; dmesg | tail -n 20"))
    print(f"{checks.passed} passed, {checks.failed} failed", flush=True)
    return int(checks.failed > 0 or checks.passed == 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
