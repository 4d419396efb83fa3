# SPDX-License-Identifier: MIT
# Make the SJA1000 of can0 go bus-off, for bus_off.sh.
#
# The controller of QEMU 7.2 cannot go bus-off: it ignores writes to its error counters, and never sets bit 7 (bus status) of its
# status register. So gdb changes two values between the controller and the kernel: at its next interrupt, the driver of can0 reads
# an error interrupt, and bus-off in the status. The driver then stops can0, sends an error frame and restarts the controller.
# Until then the controller still receives; a true one does not.
#
# $interrupt and $read_reg are the addresses of sja1000_interrupt(irq, device) and kvaser_pci_read_reg(controller, register). A
# function gets its arguments in rdi and rsi, and returns in rax.
set pagination off
set architecture i386:x86-64
target remote .vm/gdb

define return_from_function
    set $rax = $arg0
    set $rip = *(unsigned long *)$rsp
    set $rsp = $rsp + 8
end

# The name is the first member of struct net_device: "can0".
thbreak *$interrupt if *(unsigned int *)$rsi == 0x306e6163
continue
# Register 3, IR: bit 2 is the error interrupt.
thbreak *$read_reg if (unsigned char)$rsi == 3
continue
return_from_function 0x04
# Register 2, SR: bus-off, error limit exceeded, transmit buffer free.
thbreak *$read_reg if (unsigned char)$rsi == 2
continue
return_from_function 0xcc
detach
