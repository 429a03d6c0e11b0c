test_@t@.elf: @n@.c test_@n@.c cortex_m.c @headers@ cortex_m.h cortex_m.ld built_with
	$(CROSS)gcc $(CFLAGS) -DON_BOARD @machine@ \
	  @n@.c test_@n@.c cortex_m.c -o $@ \
	  @link@ -lm

@t@: test_@t@.elf vectors.bin
	$(QEMU) -M @board@ @run@ -serial none @count@ -kernel $<
//@ if xcp

xcp_@t@.elf: @n@.c xcp.c xcp_board.c cortex_m.c @headers@ xcp.h cortex_m.h cortex_m.ld built_with
	$(CROSS)gcc $(CFLAGS) @machine@ @n@.c xcp.c xcp_board.c cortex_m.c -o $@ \
	  @link@ -lm

xcp_@t@: xcp_@t@.elf # its serial line is a terminal of this machine, which QEMU names
	$(QEMU) -M @board@ @run@ -serial pty -kernel $<
//@ end
