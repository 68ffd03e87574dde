"""Inputs that kernels are tested and measured on: pictures, triangle soups, patches."""
