# Targets:
#   conduit_ring::conduit_ring         C: conduit_ring.h and the shared library
#   conduit_ring::conduit_ring_static  the same with the static library
#   conduit_ring::conduit_core         C++17: conduit_core/*.hpp; aliases: conduit_core,
#                                      conduit_core::conduit_core, conduit::conduit_core
# Expects _conduit_ring_include_dir and _conduit_ring_library_dir.
include(CMakeFindDependencyMacro)
find_dependency(Threads)

if(NOT TARGET conduit_ring::conduit_ring)
  add_library(conduit_ring::conduit_ring SHARED IMPORTED GLOBAL)
  set_target_properties(conduit_ring::conduit_ring PROPERTIES
    IMPORTED_LOCATION "${_conduit_ring_library_dir}/libconduit_ring.so.2"
    IMPORTED_SONAME "libconduit_ring.so.2"
    INTERFACE_INCLUDE_DIRECTORIES "${_conduit_ring_include_dir}"
    INTERFACE_LINK_LIBRARIES Threads::Threads)

  add_library(conduit_ring::conduit_ring_static STATIC IMPORTED GLOBAL)
  set_target_properties(conduit_ring::conduit_ring_static PROPERTIES
    IMPORTED_LOCATION "${_conduit_ring_library_dir}/libconduit_ring.a"
    INTERFACE_INCLUDE_DIRECTORIES "${_conduit_ring_include_dir}"
    INTERFACE_LINK_LIBRARIES "Threads::Threads;${CMAKE_DL_LIBS};m")

  foreach(_conduit_ring_name
      conduit_ring::conduit_core conduit_core conduit_core::conduit_core conduit::conduit_core)
    add_library(${_conduit_ring_name} INTERFACE IMPORTED GLOBAL)
    set_target_properties(${_conduit_ring_name} PROPERTIES
      INTERFACE_LINK_LIBRARIES conduit_ring::conduit_ring
      INTERFACE_COMPILE_FEATURES cxx_std_17)
  endforeach()
  unset(_conduit_ring_name)
endif()

unset(_conduit_ring_include_dir)
unset(_conduit_ring_library_dir)
