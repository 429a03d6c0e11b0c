"""What is measured on a vehicle, and the speed that is made of it."""
