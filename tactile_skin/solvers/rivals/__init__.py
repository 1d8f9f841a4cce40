"""What explains a frame that skin and circuit do not, or explains it better."""
