"""What was felt, for the eye and the ear: plots, a picture, sound. Knows the core; the core knows none of it."""
