"""One rigid bearing by itself: operating point, forces, flows and linear coefficients."""
