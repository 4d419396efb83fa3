# SPDX-License-Identifier: MIT
# Files of the Python package besides its modules, for the build of a wheel (pyproject.toml): the library, dahl-loop, the public
# headers, the bus description, the scenes and their keys. tools/dahl/paths.py finds them.
set(DAHL_BUILD_FLOAT ON)
set(DAHL_BUILD_BATCH ON)
set(DAHL_BUILD_SHARED ON)
set(DAHL_INSTALL OFF)

# dahl-loop needs Linux. On another system the wheel has no dahl-loop, and `dahl demo` reports the reason.
if(CMAKE_SYSTEM_NAME STREQUAL "Linux")
    set(DAHL_BUILD_PORT ON)
    set(DAHL_BUILD_SIM ON)
else()
    message(WARNING "this wheel is built without dahl-loop, so without `dahl demo`: it needs Linux")
endif()

# Call this after all targets are defined.
function(dahl_install_wheel)
    add_custom_target(dahl_wheel DEPENDS dahl_shared dahl_binding dahl_fmu $<TARGET_NAME_IF_EXISTS:dahl-loop>)
    if(TARGET dahl_fmu_windows)
        install(FILES ${PROJECT_BINARY_DIR}/lib/dahl_fmu.dll DESTINATION dahl/lib COMPONENT python)
    endif()
    install(FILES $<TARGET_FILE:dahl_shared> DESTINATION dahl/lib RENAME libdahl.so COMPONENT python)
    install(TARGETS dahl_fmu LIBRARY DESTINATION dahl/lib COMPONENT python)
    if(TARGET dahl_module)
        install(TARGETS dahl_module LIBRARY DESTINATION dahl/lib COMPONENT python)
    endif()
    install(DIRECTORY lib/include/ DESTINATION dahl/share/include COMPONENT python)
    install(FILES lib/node/dahl.dbc host_sim/keys.csv LICENSE DESTINATION dahl/share COMPONENT python)
    install(DIRECTORY lib/arith lib/model lib/parts DESTINATION dahl/share/lib COMPONENT python) # sources of an FMU
    install(DIRECTORY port/fmu port/mujoco port/simulators DESTINATION dahl/share COMPONENT python FILES_MATCHING PATTERN "*.[ch]")
    install(DIRECTORY host_sim/scenes DESTINATION dahl/share COMPONENT python)
    if(TARGET dahl-loop)
        install(TARGETS dahl-loop RUNTIME DESTINATION dahl/bin COMPONENT python)
    endif()
endfunction()
