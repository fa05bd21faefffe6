#!/usr/bin/env python3
"""An encoder with 16 bits in some lines of its own, for `biss read exec:`. Positions go up by 1000 a frame."""
import os
import sys

TICK_NS = 8
TIMEOUT = 20_000 // TICK_NS


def bits(value, width):
    return [value >> place & 1 for place in reversed(range(width))]


def crc6(data):
    crc = 0
    for bit in data:
        feedback = bit ^ crc >> 5
        crc = crc << 1 & 0x3F ^ (0x03 if feedback else 0)
    return crc


def frame(position):
    """What SLO shows from rising edge 1 on: LAT, Ack, start, CDS, then position, nE, nW and the inverted CRC."""
    data = bits(position, 16) + [1, 1]
    return [1, 0, 1, 0] + data + bits(crc6(data) ^ 0x3F, 6)


position, shown = 0, []
ma, slo, still = 1, 1, 0
armed, edges = False, 0
while levels := os.read(0, 4096):
    answers = bytearray()
    for level in levels:
        level -= ord("0")
        still = still + 1 if level == ma else 0
        if level < ma:
            armed = True
        if level > ma and armed:
            if edges == 0:
                position = (position + 1000) % (1 << 16)
                shown = frame(position)
            # Stop bit and timeout: 0.
            slo = shown[edges] if edges < len(shown) else 0
            edges += 1
        if still == TIMEOUT:
            slo, armed, edges = 1, False, 0
        ma = level
        answers.append(ord("0") + slo)
    sys.stdout.buffer.write(answers)
    sys.stdout.buffer.flush()
