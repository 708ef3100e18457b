"""Studies: many searches compared fairly, resumable, on one machine or many."""
