"""Models of wheels, rails, brakes and controllers: the pages of equations a user edits."""
