# SPDX-License-Identifier: MIT
# Files of the Python package besides its modules, for the build of a wheel (pyproject.toml): the library, dahl-loop, the public
# headers, the bus description, the scenes. tools/dahl/paths.py finds them.
set(DAHL_BUILD_FLOAT ON)
set(DAHL_BUILD_BATCH ON)
set(DAHL_BUILD_SHARED ON)
set(DAHL_INSTALL OFF)

# dahl-loop needs Linux and three small libraries. The wheel does not contain them: at run time it uses those of the system, and
# tools/dahl/sim/loop.py reports a missing one. If one is missing during the build, the wheel has no dahl-loop, and `dahl demo`
# reports the reason.
find_path(INIH_INCLUDE ini.h)
find_library(INIH_LIBRARY inih)
find_path(CSV_INCLUDE csv.h)
find_library(CSV_LIBRARY csv)
find_path(CJSON_INCLUDE cjson/cJSON.h)
find_library(CJSON_LIBRARY cjson)
set(dahl_wheel_lacks "")
foreach(name INIH CSV CJSON)
    if(NOT ${name}_INCLUDE OR NOT ${name}_LIBRARY)
        string(TOLOWER "lib${name}-dev" package)
        list(APPEND dahl_wheel_lacks ${package})
    endif()
endforeach()
if(NOT CMAKE_SYSTEM_NAME STREQUAL "Linux")
    list(APPEND dahl_wheel_lacks "Linux")
endif()
list(JOIN dahl_wheel_lacks " " dahl_wheel_lacks)
if(dahl_wheel_lacks)
    message(WARNING "this wheel is built without dahl-loop, so without `dahl demo`; missing: ${dahl_wheel_lacks}")
else()
    set(DAHL_BUILD_PORT ON)
    set(DAHL_BUILD_SIM ON)
endif()

# Call this after all targets are defined.
function(dahl_install_wheel)
    add_custom_target(dahl_wheel DEPENDS dahl_shared dahl_binding dahl_fmu $<TARGET_NAME_IF_EXISTS:dahl-loop>)
    install(FILES $<TARGET_FILE:dahl_shared> DESTINATION dahl/lib RENAME libdahl.so COMPONENT python)
    install(FILES ${CMAKE_BINARY_DIR}/lib/dahl_declarations.h DESTINATION dahl/lib COMPONENT python)
    install(TARGETS dahl_fmu LIBRARY DESTINATION dahl/lib COMPONENT python)
    if(TARGET dahl_module)
        install(TARGETS dahl_module LIBRARY DESTINATION dahl/lib COMPONENT python)
    endif()
    install(DIRECTORY lib/include/ DESTINATION dahl/share/include COMPONENT python)
    install(FILES lib/node/dahl.dbc LICENSE DESTINATION dahl/share COMPONENT python)
    install(DIRECTORY lib/arith lib/model lib/parts DESTINATION dahl/share/lib COMPONENT python) # sources of an FMU
    install(DIRECTORY port/fmu DESTINATION dahl/share COMPONENT python FILES_MATCHING PATTERN "*.[ch]")
    install(FILES host_sim/scene_keys.def host_sim/timing.h DESTINATION dahl/share COMPONENT python)
    install(DIRECTORY host_sim/scenes DESTINATION dahl/share COMPONENT python)
    install(DIRECTORY port/mujoco DESTINATION dahl/share COMPONENT python) # compiled when Python imports dahl.mujoco
    if(TARGET dahl-loop)
        install(TARGETS dahl-loop RUNTIME DESTINATION dahl/bin COMPONENT python)
    else()
        file(CONFIGURE OUTPUT no-dahl-loop.txt CONTENT "${dahl_wheel_lacks}\n")
        install(FILES ${CMAKE_CURRENT_BINARY_DIR}/no-dahl-loop.txt DESTINATION dahl/share COMPONENT python)
    endif()
endfunction()
