"""What several folders use."""
