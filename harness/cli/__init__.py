"""Commands of `bench` with a file of their own: their options, and what runs then."""
