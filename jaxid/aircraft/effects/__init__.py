"""Effects that an aircraft model may lack."""
