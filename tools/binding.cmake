# SPDX-License-Identifier: MIT
# The declarations that Python reads of the C library, from its headers: see docs/decisions.
#   dahl_declarations.h  the headers after the preprocessor, with their #defines; needs the C compiler alone
#   _dahl.abi3.so        a module of cffi whose calls cost half; needs cffi and Python.h, and is left out without them
# Both lie next to libdahl.so. tools/dahl/binding/library.py loads them.
# Shaft and controller of dahl-loop are in libdahl.so too, for the simulations in Python.
set(headers dahl.h dahl_encoder.h dahl_parts.h dahl_compensator.h dahl_float.h dahl_batch.h dahl_can_bus.h dahl_frames.h dahl_node.h)
set(sim ${PROJECT_SOURCE_DIR}/host_sim)
set(sim_headers rotor.h controller.h)
target_sources(dahl_shared PRIVATE ${sim}/rotor.c ${sim}/controller.c)
set(include ${PROJECT_SOURCE_DIR}/lib/include)
set(work ${PROJECT_BINARY_DIR}/binding)
set(declarations ${PROJECT_BINARY_DIR}/lib/dahl_declarations.h)

list(TRANSFORM headers PREPEND "${include}/" OUTPUT_VARIABLE header_files)
list(TRANSFORM sim_headers PREPEND "${sim}/" OUTPUT_VARIABLE sim_files)
list(APPEND headers ${sim_headers})
list(TRANSFORM headers REPLACE "(.+)" "#include \"\\1\"\n" OUTPUT_VARIABLE lines)
list(JOIN lines "" lines)
file(CONFIGURE OUTPUT ${work}/all.h CONTENT "${lines}")
foreach(name stdint stdbool stddef) # empty: cffi knows their types
    file(CONFIGURE OUTPUT ${work}/std/${name}.h CONTENT "")
endforeach()
add_custom_command(OUTPUT ${declarations}
    COMMAND ${CMAKE_C_COMPILER} -E -P -dD -nostdinc -U__GNUC__ -I${work}/std -I${include} -I${sim} ${work}/all.h -o ${declarations}
    DEPENDS ${header_files} ${sim_files} ${work}/all.h VERBATIM)
set(binding_files ${declarations})

if(NOT Python3_EXECUTABLE AND EXISTS ${PROJECT_SOURCE_DIR}/build/venv/bin/python)
    set(Python3_EXECUTABLE ${PROJECT_SOURCE_DIR}/build/venv/bin/python)
endif()
find_package(Python3 COMPONENTS Interpreter QUIET)
set(python_include "")
if(Python3_FOUND)
    execute_process(COMMAND ${Python3_EXECUTABLE} -c "import cffi, sysconfig; print(sysconfig.get_path('include'), end='')"
        OUTPUT_VARIABLE python_include ERROR_QUIET)
endif()
if(EXISTS "${python_include}/Python.h" AND CMAKE_C_COMPILER_ID MATCHES "GNU|Clang")
    set(generator ${PROJECT_SOURCE_DIR}/tools/generators/binding.py)
    add_custom_command(OUTPUT ${work}/_dahl.c
        COMMAND ${Python3_EXECUTABLE} ${generator} ${declarations} ${headers} ${work}/_dahl.c
        DEPENDS ${declarations} ${generator} ${PROJECT_SOURCE_DIR}/tools/dahl/binding/declarations.py VERBATIM)
    add_library(dahl_module MODULE ${work}/_dahl.c)
    target_include_directories(dahl_module PRIVATE ${include} ${sim})
    target_include_directories(dahl_module SYSTEM PRIVATE ${python_include})
    # The library is loaded first, so that $DAHL_LIBRARY chooses it: the module leaves its functions undefined.
    set_target_properties(dahl_module PROPERTIES PREFIX "" OUTPUT_NAME _dahl SUFFIX .abi3.so
        LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/lib)
    list(APPEND binding_files dahl_module)
endif()
add_custom_target(dahl_binding ALL DEPENDS ${binding_files})
add_dependencies(dahl_binding dahl_shared)
