"""The running skin: latency, signals, hours, recordings, the page."""
