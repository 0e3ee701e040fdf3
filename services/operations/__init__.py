"""What whoever runs a deployment does with its data, while no service owns it."""
