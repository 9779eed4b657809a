# Runs in the guest as root: install the package, test, leave the verdict, switch off.
cd /mnt/share
read -r suite soak_s < arguments
{
    echo "guest up after $(cut -d' ' -f1 /proc/uptime) s: $(uname -r), $(systemctl --version | head -n 1)"
    dpkg --force-unsafe-io --install ptzd_*.deb && echo "package installed after $(cut -d' ' -f1 /proc/uptime) s"
    PYTHONPATH=/mnt/share PYTHONDONTWRITEBYTECODE=1 /usr/lib/ptzd/bin/python3 -u run_tests.py "$suite" "$soak_s"
} > out.txt 2>&1
echo $? > verdict
sync
echo o > /proc/sysrq-trigger
sleep 60
