"""Damage to the bytes of a file, the same for the same seed."""

import random
import re

EXTREMES = (
    *(b"0", b"-1", b"1e999", b"-1e300", b"1e-320", b"nan", b"inf", b"0.5", b"true"),
    *(b"99999999999999999999", b"60000000", b"300000000", b"-2147483649", b"65536"),
    *(b"", b"[]", b"{}", b"null", b'""', b"..", b"/etc/passwd", b"\xff\xfe", b"\0"),
    b"7" * 400,
)
NUMBER = re.compile(rb"-?[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?")
WORD = re.compile(rb"[^\s,:=\[\]{}]+")


def mutated(content: bytes, seed: str, *, head: int = 0) -> bytes:
    """Return the content with one to four kinds of damage.

    Half of the damage falls into the first `head` bytes, if there is such a header.
    """
    rng = random.Random(seed)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        damage = rng.choice(DAMAGE)
        if 0 < head < len(content) and rng.random() < 0.5:
            content = damage(rng, content[:head]) + content[head:]
        else:
            content = damage(rng, content)
    return content


def _flip(rng: random.Random, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 8))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut(rng: random.Random, content: bytes) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _drop(rng: random.Random, content: bytes) -> bytes:
    start = rng.randrange(len(content) + 1)
    return content[:start] + content[start + rng.randrange(1, 40) :]


def _insert(rng: random.Random, content: bytes) -> bytes:
    start = rng.randrange(len(content) + 1)
    return content[:start] + rng.choice(EXTREMES) + content[start:]


def _replace(pattern: re.Pattern, rng: random.Random, content: bytes) -> bytes:
    """Put an extreme value in place of a number or a word."""
    start = rng.randrange(len(content) + 1)
    found = pattern.search(content, start) or pattern.search(content)
    if found is None:
        return content
    low, high = found.span()
    return content[:low] + rng.choice(EXTREMES) + content[high:]


def _integer(rng: random.Random, content: bytes) -> bytes:
    """Overwrite 1, 2, 4 or 8 bytes with an extreme integer."""
    size = rng.choice((1, 2, 4, 8))
    value = rng.choice((0, 1, 2 ** (8 * size) - 1, 2 ** (8 * size - 1)))
    start = rng.randrange(max(len(content) - size, 0) + 1)
    new = value.to_bytes(size, rng.choice(("little", "big")))
    return content[:start] + new + content[start + size :]


def _lines(rng: random.Random, content: bytes) -> bytes:
    """Repeat, swap or remove lines."""
    lines = content.splitlines(keepends=True) or [b""]
    i, j = (rng.randrange(len(lines)) for _ in range(2))
    kind = rng.randrange(3)
    if kind == 0:
        lines.insert(i, lines[j])
    elif kind == 1:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        del lines[i]
    return b"".join(lines)


def _nest(rng: random.Random, content: bytes) -> bytes:
    """Open many brackets."""
    start = rng.randrange(len(content) + 1)
    return content[:start] + rng.choice((b"[", b"{", b"(")) * 100_000 + content[start:]


DAMAGE = (
    *(_flip, _flip, _flip, _cut, _drop, _insert, _integer, _lines),
    *(lambda rng, content: _replace(NUMBER, rng, content),) * 3,
    lambda rng, content: _replace(WORD, rng, content),
    _nest,
)
