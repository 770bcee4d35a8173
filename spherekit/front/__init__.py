"""What Python users call: thin functions over the other layers."""
