"""What is measured on a vehicle, the speed that is made of it, and what a controller believes."""
