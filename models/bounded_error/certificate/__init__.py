"""One error inside its bounds, alone or behind a lag: intervals, polygons, and runs that leave."""
