# SPDX-License-Identifier: MIT
# The library as an ESP-IDF component; the top CMakeLists.txt comes here when ESP-IDF reads it.
file(GLOB dahl_sources ${CMAKE_CURRENT_LIST_DIR}/../../lib/*.c)
idf_component_register(SRCS ${dahl_sources} INCLUDE_DIRS ${CMAKE_CURRENT_LIST_DIR}/../../lib)
