"""What the device can do at best: copying and arithmetic."""
