"""Comparing search methods: studies, their analysis, their report."""
