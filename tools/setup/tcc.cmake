# SPDX-License-Identifier: MIT
# tcc, the small compiler by which the demo builds on a machine without another. What CMake does not know of it: where the
# libraries of this Debian lie, how it tells which headers a source includes, and that it makes archives itself.
file(GLOB libc RELATIVE /usr/lib /usr/lib/*-linux-gnu/libc.so)
if(libc AND NOT CMAKE_LIBRARY_ARCHITECTURE)
    list(GET libc 0 libc)
    get_filename_component(CMAKE_LIBRARY_ARCHITECTURE ${libc} DIRECTORY)
endif()
set(CMAKE_DEPFILE_FLAGS_C "-MD -MF <DEP_FILE>")
set(CMAKE_C_DEPFILE_FORMAT gcc)
set(CMAKE_C_DEPENDS_USE_COMPILER TRUE)
set(CMAKE_C_ARCHIVE_CREATE "<CMAKE_C_COMPILER> -ar rcs <TARGET> <OBJECTS>")
set(CMAKE_C_ARCHIVE_APPEND "")
set(CMAKE_C_ARCHIVE_FINISH "")
