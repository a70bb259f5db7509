"""Touch in the browser: a page with a picture of the scene from above, which mouse, pen and fingers stroke."""
