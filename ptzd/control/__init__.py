"""The sans-IO core: events in, commands out, one transition table."""
