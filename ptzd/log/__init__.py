"""The black box: every event, command and picture in MCAP files that survive a crash and replay alone."""
