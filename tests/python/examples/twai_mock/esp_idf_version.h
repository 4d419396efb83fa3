/* SPDX-License-Identifier: MIT */
/* The oldest version that the example supports, unless a test gives another one. */
#define ESP_IDF_VERSION_VAL(major, minor, patch) ((major << 16) | (minor << 8) | (patch))
#ifdef MOCK_IDF_6_0
#define ESP_IDF_VERSION ESP_IDF_VERSION_VAL(6, 0, 0)
#elif defined(MOCK_IDF_5_5)
#define ESP_IDF_VERSION ESP_IDF_VERSION_VAL(5, 5, 0)
#else
#define ESP_IDF_VERSION ESP_IDF_VERSION_VAL(5, 0, 0)
#endif

const char *esp_get_idf_version(void);
