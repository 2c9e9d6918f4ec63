# The wheels' Fast DDS asks for OpenSSL's development files but carries a copy of the library itself, and nothing here
# is compiled against it. An empty find module saves the package.
foreach(part SSL Crypto)
  if(NOT TARGET OpenSSL::${part})
    add_library(OpenSSL::${part} INTERFACE IMPORTED)
  endif()
endforeach()
set(OpenSSL_FOUND TRUE)
set(OPENSSL_FOUND TRUE)
