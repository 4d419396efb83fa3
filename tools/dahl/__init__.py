# SPDX-License-Identifier: MIT
"""dahl"""
