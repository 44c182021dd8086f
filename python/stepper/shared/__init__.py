"""Code that several folders use."""
