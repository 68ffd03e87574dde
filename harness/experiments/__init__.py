"""The papers' own experiments, their claims, and the documents' tables."""
