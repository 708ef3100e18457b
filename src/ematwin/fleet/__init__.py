"""A fleet over time: every judged recording kept, trends, alarms, life left, and pages of it."""
