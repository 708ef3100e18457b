"""Position servo: a geared DC motor that is commanded a position and has its controller inside."""
