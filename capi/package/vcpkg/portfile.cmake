# From a clone of the repository: vcpkg install deltamorph --overlay-ports=capi/package/vcpkg
# Needs cargo, and what cargo fetches.
set(VCPKG_BUILD_TYPE release)
get_filename_component(SOURCE_PATH "${CURRENT_PORT_DIR}/../../.." ABSOLUTE)
set(target "${CURRENT_BUILDTREES_DIR}/${TARGET_TRIPLET}-rel")

find_program(CARGO cargo PATHS "$ENV{HOME}/.cargo/bin" REQUIRED)
vcpkg_execute_required_process(
    COMMAND "${CARGO}" build --locked --profile small --package deltamorph-c --all-features --target-dir "${target}"
    WORKING_DIRECTORY "${SOURCE_PATH}"
    LOGNAME "cargo-${TARGET_TRIPLET}"
)
vcpkg_execute_required_process(
    COMMAND "${SOURCE_PATH}/capi/install" "${CURRENT_PACKAGES_DIR}" "${target}/small"
    WORKING_DIRECTORY "${SOURCE_PATH}"
    LOGNAME "install-${TARGET_TRIPLET}"
)
if(VCPKG_LIBRARY_LINKAGE STREQUAL "dynamic")
    set(other "a")
else()
    set(other "[sd]*")
endif()
file(GLOB other "${CURRENT_PACKAGES_DIR}/lib/libdeltamorph_c.${other}")
file(REMOVE ${other})

vcpkg_cmake_config_fixup(CONFIG_PATH lib/cmake/deltamorph)
vcpkg_replace_string("${CURRENT_PACKAGES_DIR}/share/deltamorph/deltamorphConfig.cmake" "/../../.." "/../..")
vcpkg_fixup_pkgconfig()
vcpkg_install_copyright(FILE_LIST "${SOURCE_PATH}/LICENSE-MIT" "${SOURCE_PATH}/LICENSE-APACHE")
