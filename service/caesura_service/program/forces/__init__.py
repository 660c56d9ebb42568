"""Forces of a demonstration: the sensor's bias, and what was pressed in a press or a stroke."""
