"""What a warehouse is and decides: values and functions; time is a parameter."""
