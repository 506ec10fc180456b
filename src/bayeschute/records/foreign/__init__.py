"""Records as others write them: axes, attitudes, winds and clocks of other conventions, turned into the schema's."""
