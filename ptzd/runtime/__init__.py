"""The shell around the core: the pump, the perception worker, readiness and watchdog."""
