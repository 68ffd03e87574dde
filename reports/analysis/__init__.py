"""What results say: comparisons, fronts, claims."""
