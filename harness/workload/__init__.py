"""What is equal for every method: settings, views, visible sets, frames, the reference."""
