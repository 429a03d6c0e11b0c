# Written by slipctl. Compiles for a Cortex-M; the test runs on a board of QEMU:
#   cmake -B build -DCMAKE_TOOLCHAIN_FILE=@toolchain@ -DTARGET=@first@
#   cmake --build build
#   ctest --test-dir build
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(TARGET "@first@" CACHE STRING "@targets@")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES TARGET)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY) # a program needs the linker script

set(CMAKE_C_COMPILER @tools@gcc)
@chosen@
else()
  message(FATAL_ERROR "TARGET ${TARGET} is not known; give @targets@")
endif()

find_program(QEMU @emulator@)
if(QEMU)
  set(CMAKE_CROSSCOMPILING_EMULATOR
    ${QEMU} -M ${BOARD} @run@ -kernel)
endif()
