"""Hand labels of the ego lane's two lines, marked in a local web page (`python -m lanes label`)."""
