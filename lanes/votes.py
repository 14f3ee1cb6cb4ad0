import numpy as np
from lanes.lanefit import *

BIN = 0.15
REACH = 4.5
def hypotheses():
    k = np.arange(-15, 16)
    curv = np.sign(k) * 0.0012 * (np.exp(np.abs(k) * 0.26) - 1) / 0.26
    k = np.arange(-12, 13)
    head = np.sign(k) * 0.015 * (np.exp(np.abs(k) * 0.09) - 1) / 0.09
    pitch = np.arange(-2, 3) * 0.012
    h, c, d = np.meshgrid(head, curv, pitch, indexing="ij")
    return h.ravel(), c.ravel(), d.ravel()


def vote(stripes, height, far=22.0):
    head, curv, pitch = hypotheses()
    near = stripes.x_m < far
    x, y = stripes.x_m[near], stripes.y_m[near]
    w = confidence(stripes)[near].astype(np.float32)
    bins = int(2 * REACH / BIN) + 2
    H = np.zeros((len(head), bins), np.float32)
    ps, inv = np.unique(pitch, return_inverse=True)
    for i, dp in enumerate(ps):
        xs, ys = flatten_pitch(x, y, dp, height)
        sel = np.flatnonzero(inv == i)
        a = distance_to_arc(xs.astype(np.float32)[None], ys.astype(np.float32)[None], head[sel].astype(np.float32)[:, None], curv[sel].astype(np.float32)[:, None])
        th = flatten_angle(x, y, stripes.angle[near], dp, height).astype(np.float32)
        k = curv[sel].astype(np.float32)[:, None]
        sin = (np.sin(head[sel]).astype(np.float32)[:, None] + k * xs.astype(np.float32)) / np.maximum(1 - k * a, 0.2)
        miss = np.arcsin(np.clip(sin, -1, 1)) - th[None]
        ww = w[None] / (1 + (miss / 0.12) ** 2) ** 2
        idx = np.clip((a + REACH) / BIN, 0, bins - 1).astype(np.int32)
        flat = idx + np.arange(len(sel), dtype=np.int32)[:, None] * bins
        H[sel] = np.bincount(flat.ravel(), ww.ravel(), minlength=len(sel) * bins).reshape(len(sel), bins)
    H[:, 0] = H[:, -1] = 0
    return (head, curv, pitch), H


def pairs(hyp, H, rows, top=8):
    """best (score, p) list"""
    head, curv, pitch = hyp
    S = H.copy()
    S[:, 1:-1] = H[:, 1:-1] + 0.6 * (H[:, :-2] + H[:, 2:])
    centre = (np.arange(H.shape[1]) + 0.5) * BIN - REACH
    G = np.sqrt(S / rows)
    left = np.flatnonzero((centre > 0.3) & (centre < 3.6))
    right = np.flatnonzero((centre < -0.3) & (centre > -3.6))
    W = centre[left][:, None] - centre[right][None]
    C = (centre[left][:, None] + centre[right][None]) / 2
    prior = -0.5 * ((W - 3.5) / 0.5) ** 2 * 0.1 - 0.5 * (C / 0.7) ** 2 * 0.1
    hp = -0.5 * (head / 0.15) ** 2 * 0.1 - 0.5 * (pitch / 0.015) ** 2 * 0.1 - 0.5 * (curv / 0.05) ** 2 * .1
    bound = G[:, left].max(1) + G[:, right].max(1) + hp
    best = np.argsort(-bound)[:300]
    sc = G[best][:, left, None] + G[best][:, None, right] + prior + hp[best, None, None]
    flat = sc.reshape(len(best), -1)
    arg = flat.argmax(1)
    val = flat[np.arange(len(best)), arg]
    order = np.argsort(-val)
    out = []
    for o in order:
        i, j = np.unravel_index(arg[o], W.shape)
        p = np.array([C[i, j], W[i, j], head[best[o]], curv[best[o]], 0, pitch[best[o]]])
        if all(np.any(np.abs(p - q)[[0, 1]] > 0.35) or abs(p[3]-q[3])>.3*abs(p[3])+.002 for _, q in out):
            out.append((val[o], p))
        if len(out) >= top:
            break
    return out
