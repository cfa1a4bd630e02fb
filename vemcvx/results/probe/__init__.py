"""What results say at any points of the body, and along lines."""
