# SPDX-License-Identifier: MIT
# The library as an ESP-IDF component. The top CMakeLists.txt includes this file if ESP-IDF reads it.
set(dahl_lib ${CMAKE_CURRENT_LIST_DIR}/../../lib)
file(GLOB dahl_sources ${dahl_lib}/arith/*.c ${dahl_lib}/model/*.c ${dahl_lib}/node/*.c ${dahl_lib}/parts/*.c ${dahl_lib}/compensator/*.c ${dahl_lib}/commission/*.c)
idf_component_register(SRCS ${dahl_sources} INCLUDE_DIRS ${dahl_lib}/include)
