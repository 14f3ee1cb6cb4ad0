"""Wrong answers to the exercises of chapter 5: code that sets it, and a part of its hint."""

_MASK = "def paint_mask(above):\n    hls = cv2.cvtColor(above, cv2.COLOR_RGB2HLS)\n    return "
_EDGES = """
def relative_edges(lightness):
    edges = np.abs(cv2.Sobel(lightness, cv2.CV_32F, 1, 0, ksize=3)) / 4
    return """

WRONG_ANSWERS = {
    "5.1": [
        (_MASK + "cv2.inRange(hls[..., 1], 100, 255)", "Too many pixels are not paint"),
        ('paint_mask = lambda above: recipes["hls_sobel"].thresholds.masks(above)["combined"]', "Too many pixels"),
        ("paint_mask = helpers.saturation_mask", "white dashes are missing"),
        (_MASK + "hls[..., 2] * 0", "the mask is empty"),
        (_MASK + "hls", "a mask has the shape"),
    ],
    "5.2": [
        (_EDGES + "np.where(edges >= 6, 255, 0).astype(np.uint8)", "Divide the gradient by the brightness"),
        (_EDGES + "np.where(edges >= 0.1 * edges.max(), 255, 0).astype(np.uint8)", "no scale"),
        (_EDGES + "np.where(edges >= 0.1 * lightness.max(), 255, 0).astype(np.uint8)", "no scale"),
        (_EDGES + "np.where(edges >= 0, 255, 0).astype(np.uint8)", "covers 100%"),
        (_EDGES + "edges", "a mask has the shape"),
    ],
}
