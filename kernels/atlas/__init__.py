"""A client's picture from an atlas: where surface points lie in it, and what is there."""
