"""Picture metrics, and the stretch of an atlas."""
