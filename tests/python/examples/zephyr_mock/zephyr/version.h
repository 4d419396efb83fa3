/* SPDX-License-Identifier: MIT */
/* The oldest version that the example supports, unless a test gives another one. */
#define ZEPHYR_VERSION(a, b, c) (((a) << 16) + ((b) << 8) + (c))
#ifdef MOCK_ZEPHYR_4_5
#define ZEPHYR_VERSION_CODE ZEPHYR_VERSION(4, 5, 0)
#else
#define ZEPHYR_VERSION_CODE ZEPHYR_VERSION(3, 7, 0)
#endif
