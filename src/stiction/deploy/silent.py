"""onnxruntime, told before it is loaded to report nothing.

From release 1.29 on its wheels keep an identifier of the machine, and send their maker an account of every session,
unless this variable says otherwise when they are loaded. A robot does not do that unasked.
"""

import os

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime

__all__ = ["onnxruntime"]
