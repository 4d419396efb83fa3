# SPDX-License-Identifier: MIT
# _dahl.abi3.so, a module of cffi for Python whose calls cost half; needs cffi and Python.h, and is left out without them. It lies
# next to libdahl.so; tools/dahl/binding/library.py loads both. tools/generators/facts.py writes its declarations.
# Shaft and controller of dahl-loop are in libdahl.so too, for the simulations in Python.
set(headers dahl.h dahl_encoder.h dahl_parts.h dahl_compensator.h dahl_commission.h dahl_float.h dahl_batch.h dahl_can_bus.h
    dahl_frames.h dahl_node.h rotor.h controller.h compare/compare.h)
set(sim ${PROJECT_SOURCE_DIR}/host_sim)
set(simulated ${sim}/rotor.c ${sim}/controller.c ${sim}/compare/compare.c ${sim}/compare/library_law.c ${sim}/compare/rivals.c
    ${sim}/compare/true_friction.c)
target_sources(dahl_shared PRIVATE ${simulated})
# Only the names of the library are unique in one unit.
set_source_files_properties(${simulated} TARGET_DIRECTORY dahl_shared PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
set(declarations ${PROJECT_SOURCE_DIR}/tools/dahl/binding/declarations.cdef)
set(module_source ${PROJECT_BINARY_DIR}/binding/_dahl.c)

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
    file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/binding)
    add_custom_command(OUTPUT ${module_source}
        COMMAND ${Python3_EXECUTABLE} ${generator} ${declarations} ${headers} ${module_source}
        DEPENDS ${declarations} ${generator} VERBATIM)
    add_library(dahl_module MODULE ${module_source})
    target_include_directories(dahl_module PRIVATE ${PROJECT_SOURCE_DIR}/lib/include ${sim})
    target_include_directories(dahl_module SYSTEM PRIVATE ${python_include})
    # The library is loaded first, so that $DAHL_LIBRARY chooses it: the module leaves its functions undefined.
    set_target_properties(dahl_module PROPERTIES PREFIX "" OUTPUT_NAME _dahl SUFFIX .abi3.so
        LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/lib)
endif()
add_custom_target(dahl_binding ALL DEPENDS dahl_shared $<TARGET_NAME_IF_EXISTS:dahl_module>)
