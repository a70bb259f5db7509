"""The painter without a browser: painting, strokes, document, history, tuning, composing, display."""
