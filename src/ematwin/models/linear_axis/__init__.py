"""Linear axis: a carriage on a screw, driven by voltage, under a sampled position loop."""
