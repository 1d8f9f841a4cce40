"""What is said of damaged, wrongly described and sound boards."""
